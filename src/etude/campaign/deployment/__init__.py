"""What of a campaign is in use: promotion, monitoring, exports of the model, predictions."""
