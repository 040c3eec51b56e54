"""What every request passes: layers of ASGI around all routes."""
