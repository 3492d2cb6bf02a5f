"""The reward models p(r | s, a) by which several discoverers decide."""
