"""Curves of the joints, and when the arm is where on them: the time law, and points that come with times."""
