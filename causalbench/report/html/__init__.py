"""`report.html`: one page that a stranger can open from disk, made from the store alone."""
