"""o3dls: level-set registration and reconstruction of an atrium from a prior surface and sparse points, on Open3D. Not for clinical use."""

__version__ = "0.1.0"
