"""The contract of a backend as numbered checks, for authors of backends.

The contract is docs/conformance.md; how to write a backend is docs/plugins.md. Two ways to run the same table of
checks (`causalbench.conformance.suite.CHECKS`):

- `causalbench check BACKEND` prints it;
- in the plugin's tests, pytest runs it as one test per line of the contract:

      from causalbench.conformance.testing import SceneConformance

      class TestConformance(SceneConformance):
          backend = "gymrob"

A line that does not hold and is not going to is data in the plugin, `Backend(known_gaps={"S21": "why"})`: it is
shown wherever the backend is listed, and once the check passes the gap is the error. Test names are public:
they are never changed.
"""
