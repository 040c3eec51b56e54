"""Remote control of an arm with a gamepad or a keyboard. The arm moves only while a key or a button is
held.
"""
