"""The run folder: what lies where, written so that a kill at any instant leaves every finished cell whole."""
