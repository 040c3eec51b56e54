"""The motion queue. Moves wait in it, are planned and joined, and are executed in order."""
