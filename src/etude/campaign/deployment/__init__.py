"""Deployment of a campaign: promotion, monitoring, exports of the model, predictions."""
