"""The checks of a task, one module per subject."""
