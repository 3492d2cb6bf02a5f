"""What to run: the suite file, and the plan of cells that it asks for."""
