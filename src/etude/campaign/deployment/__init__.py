"""Deployment: promotion, monitoring, exports of the model, predictions."""
