"""An author of a method imports this module alone. A `Method` names a learner and says how it is used."""

from causalbench.core.learners.methods import Control, Method
from causalbench.errors import UserError
from causalbench.plugins.hookspecs import hookimpl

__all__ = ["Control", "Method", "UserError", "hookimpl"]
