"""What is asked of the planners, apart from them: whoever only asks imports no algorithm."""
