"""Geometry of the edge: places on WGS84, and the flat ground that a camera sees.

Floats live here and end here: what leaves for the core is a `Place` of integers. Nothing here
knows a camera, a link or a configuration; everything is plain numbers in named units.
"""

from autopilot.geo.frame import LocalFrame as LocalFrame
from autopilot.geo.frame import Origin as Origin
from autopilot.geo.frame import offset as offset
from autopilot.geo.frame import with_error as with_error
from autopilot.geo.ground import GroundPoint as GroundPoint
from autopilot.geo.ground import NoPlace as NoPlace
from autopilot.geo.ground import View as View
from autopilot.geo.ground import ground_point as ground_point
from autopilot.geo.ground import image_point as image_point
from autopilot.geo.ground import standing_point as standing_point
