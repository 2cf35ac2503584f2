"""The main job and the experiments of Høifødt 2011, as pages with pictures."""
