"""Exports: motions in their receivers' formats (`exporters`), models as code (`c99`, `onnx`, `ros2`), and
the trajectory files of a proposal with the command expected along them.
"""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.deploy.feedforward import MotionWithCommands
    from etude.deploy.model_states import log_of
    from etude.deploy.playback_certificate import certified_playback, certify_played
    from etude.deploy.targets.c99.header import CForm
    from etude.deploy.targets.c99.plan import Plan, planned
    from etude.deploy.targets.c99.target import Files, c_files
    from etude.deploy.targets.onnx.model_graph import Graph, parts_of, written
    from etude.deploy.targets.onnx.target import graph_inputs, session
    from etude.deploy.trajectory_files import csv_bytes, read_table

__all__ = [
    "CForm",
    "Files",
    "Graph",
    "MotionWithCommands",
    "Plan",
    "c_files",
    "certified_playback",
    "certify_played",
    "csv_bytes",
    "graph_inputs",
    "log_of",
    "parts_of",
    "planned",
    "read_table",
    "session",
    "written",
]
__getattr__, __dir__ = face(__name__)
