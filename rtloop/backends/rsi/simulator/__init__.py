"""`cobot simulate rsi`: a simulated controller of a KUKA KR robot with RSI."""
