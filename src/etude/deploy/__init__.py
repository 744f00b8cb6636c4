"""What leaves for the robot: trajectory files and the command expected along them."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.deploy.c99.header import CForm
    from etude.deploy.c99.target import Files, c_files
    from etude.deploy.onnx.model_graph import parts_of, written
    from etude.deploy.onnx.target import session, taken_by

__all__ = ["CForm", "Files", "c_files", "parts_of", "session", "taken_by", "written"]
__getattr__, __dir__ = face(__name__)
