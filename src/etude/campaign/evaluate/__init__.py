"""How good is it, and is it enough: status, stop rule, confirmation."""
