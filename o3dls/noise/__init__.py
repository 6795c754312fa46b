"""Who touches the wall: how far a point is believed, from plain robust weights to a mixture model.

One model of a catheter (`contact`) serves the pose, the motion, the level set and the topology. May import
geometry and what is below it. Start with `contact`.
"""
