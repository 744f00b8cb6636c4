"""Evidence on recorded commands: their joint, log, sign, order and direction, by one likelihood for all
logs.
"""
