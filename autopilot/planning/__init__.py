"""A mission made into what a vehicle can fly: judged on the ground, planned, translated. No clock, no I/O.

`make_plan` is the way in. It stands above the forms of the outside (`autopilot.wire`), geometry (`autopilot.geo`) and
the configuration, and below the adapters, which fetch missions and upload plans.
"""

from autopilot.planning.items import Autopilot as Autopilot
from autopilot.planning.items import PlannedItem as PlannedItem
from autopilot.planning.middle import with_middle as with_middle
from autopilot.planning.plan import Breakpoint as Breakpoint
from autopilot.planning.plan import Plan as Plan
from autopilot.planning.plan import Searched as Searched
from autopilot.planning.plan import for_vehicle as for_vehicle
from autopilot.planning.plan import make_plan as make_plan
from autopilot.planning.plan import mission_limits as mission_limits
