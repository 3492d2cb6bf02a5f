"""The checks, one module per topic. A check is a function of a `Bench`; its docstring is its line of the contract."""
