"""Laws over inputs that nobody chose."""
