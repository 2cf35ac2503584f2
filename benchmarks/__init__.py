"""Speed and accuracy, measured together."""
