"""The process that keeps the last minutes of each robot and writes recordings of them."""
