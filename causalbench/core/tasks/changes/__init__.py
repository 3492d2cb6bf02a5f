"""Tasks that differ from a registered one in what their name says, see `named.changed`."""
