"""The process that keeps the last minutes of each robot in memory and writes recordings of them."""
