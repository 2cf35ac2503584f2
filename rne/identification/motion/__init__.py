"""Models from commands and positions, without torques: output error of simulated motions."""
