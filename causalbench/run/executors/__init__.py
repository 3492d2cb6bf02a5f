"""Executors: where the cells of a run are worked on. `schedule` is the one loop; each other module is one executor."""
