"""The model file with the inertias that the logs show: fitted so that a body can have them, written back."""
