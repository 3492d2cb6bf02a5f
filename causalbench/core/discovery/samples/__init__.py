"""Step 1 of Algorithm 1: the data of a discovery."""
