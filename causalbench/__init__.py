"""causalbench: does knowing which actions cause which rewards make multi-stage robot tasks learnable?"""

__version__ = "0.1.0"
