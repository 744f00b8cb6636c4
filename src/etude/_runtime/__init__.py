"""Runtime support without a public face: BLAS, compilation, trusted folders, operators."""
