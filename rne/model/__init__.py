"""What a robot is: the Model, its validation, its construction and modification, built-in robots."""
