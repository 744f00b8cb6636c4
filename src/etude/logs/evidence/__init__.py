"""Which joint, log, sign, order and direction do recorded commands belong to? One likelihood for all logs."""
