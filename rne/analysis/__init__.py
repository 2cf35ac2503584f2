"""Analyses of motions and models: bearing loads, comparison with Pinocchio and with the energies."""
