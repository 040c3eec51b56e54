"""Moving an arm by hand from afar: a gamepad or a keyboard, for as long as something is held."""
