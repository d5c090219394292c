"""The eyes: camera and detector in a process of their own, detections and their places in the node.

`Eyes` is the node's side; it spawns `child`, or connects to a detector that somebody else runs.
OpenCV, onnxruntime and numpy are imported by the child alone.
"""

from autopilot.adapters.eyes.eyes import Eyes as Eyes
from autopilot.adapters.eyes.eyes import model_sha256 as model_sha256
