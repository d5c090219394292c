"""Safety properties written a second time (style 22): they only watch steps, and say what must never be seen.

A `Watch` sees the steps of a flight one after the other, from the manifest on or from a start of the daemon on, and
says which property each one broke. Monitors share nothing with the charts but the vocabulary, so that a guard that is
wrong and its monitor do not fail together; even whether a place lies in a fence is computed otherwise. They run in
tests, in `replay verify`, and in flight. They decide nothing, and nothing that decides knows them.
"""

from statecharts.monitors.watch import Breach as Breach
from statecharts.monitors.watch import Watch as Watch
