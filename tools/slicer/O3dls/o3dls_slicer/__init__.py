"""What the module O3dls does, free of Qt: nodes become a case, o3dls runs in a Python of its own, and its
scene is loaded.
"""
