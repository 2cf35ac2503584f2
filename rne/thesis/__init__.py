"""The experiments of Høifødt 2011 and the main job, as pages with pictures."""
