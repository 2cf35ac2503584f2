"""The experiments of Høifødt 2011 (MSc thesis, NTNU), as a page with pictures: `python -m examples.thesis`."""
