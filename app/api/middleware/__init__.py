"""ASGI middleware: layers around all routes. Every request passes through them."""
