"""This host: middleware, names that one program has at a time, signs of life, files of this user."""
