"""The study of the thesis: every figure, table and claim, the runs that answer them, and the verdicts."""
