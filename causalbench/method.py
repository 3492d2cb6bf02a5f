"""All that an author of a method imports: a row of the method table names a learner and says how it is used."""

from causalbench.core.learners.methods import Control, Method
from causalbench.errors import UserError
from causalbench.plugins.hookspecs import hookimpl

__all__ = ["Control", "Method", "UserError", "hookimpl"]
