"""From recursion to kernel: trace a function once on one robot, run it as straight-line arithmetic."""
