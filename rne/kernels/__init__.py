"""From a recursion to a kernel: a function traced once on one robot, run as straight-line arithmetic."""
