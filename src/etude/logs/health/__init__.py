"""How well was it recorded? One module a subject: the clock, the columns, the motion."""
