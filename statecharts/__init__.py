"""State and observation in, decisions out. Cannot wait, fail half-way, or look at a clock."""

from statecharts.carry import carry_over as carry_over
from statecharts.charts import CHARTS as CHARTS
from statecharts.engine import Step as Step
from statecharts.engine import charts_digest as charts_digest
from statecharts.engine import evolve as evolve
from statecharts.engine import restore as restore
from statecharts.engine import step as step
from statecharts.engine import steps_of as steps_of
from statecharts.logic import LOGIC as LOGIC
from statecharts.state import State as State
