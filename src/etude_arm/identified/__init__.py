"""Model file with identified inertias: physically consistent ones, written back."""
