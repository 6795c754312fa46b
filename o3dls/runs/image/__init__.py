"""What a finished run and the image of its prior say together."""
