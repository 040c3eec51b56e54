"""What agents see: tools, resources and prompts of the Model Context Protocol."""
