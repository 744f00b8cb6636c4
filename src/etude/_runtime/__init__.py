"""Support for all rooms that no plug-in needs: BLAS, compilation, trust, operators."""
