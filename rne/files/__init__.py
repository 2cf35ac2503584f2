"""Files of motions."""
