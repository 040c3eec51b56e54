"""The shapes and the appearance of the arm, its tool and its surroundings, and pictures of them."""
