"""What a motion or a model implies: bearing loads, comparison with Pinocchio."""
