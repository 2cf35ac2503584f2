"""Pictures and pages about a robot and its motion. Nothing is computed here that the library does not offer."""
