"""The motion queue, whose moves are planned, joined, and executed in order."""
