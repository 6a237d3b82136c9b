"""Air and stiffness in a part between solid and void."""
