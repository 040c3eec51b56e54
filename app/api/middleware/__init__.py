"""ASGI middleware: layers around all routes, which every request passes."""
