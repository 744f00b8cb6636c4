"""A model as C99: one header and one source file, its tests, and a CMake file."""
