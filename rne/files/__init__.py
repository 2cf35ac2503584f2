"""Reading and writing files of motions and of measurements."""
