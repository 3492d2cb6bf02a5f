"""The contracts of a backend and of a task as numbered checks, for their authors.

The contracts are docs/conformance.md and docs/task_conformance.md; how to write a backend is docs/plugins.md. Two ways
to run the same table of checks (`suite.CHECKS`, `task_suite.TASK_CHECKS`):

- `causalbench check BACKEND` or `causalbench check --task NAME` prints it;
- in the plugin's tests, pytest runs it as one test per line of the contract:

      from causalbench.conformance.testing import SceneConformance, TaskConformance

      class TestConformance(SceneConformance):
          backend = "gymrob"

      class TestTask(TaskConformance):
          task = "hover"

A line that does not hold and is not going to is data in the plugin, `Backend(known_gaps={"S21": "why"})`: it is
shown wherever the backend is listed, and once the check passes the gap is the error. Test names are public:
they are never changed.
"""
