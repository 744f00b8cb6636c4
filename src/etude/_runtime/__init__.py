"""What the other rooms stand on and no plug-in needs: BLAS, compilation, trust, TOML tables, operators."""
