"""`cobot simulate rsi`: a controller of a KUKA KR robot with RSI, without a robot."""
