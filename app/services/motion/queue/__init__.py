"""The motion queue: moves wait, are planned and joined, and are executed in their order."""
