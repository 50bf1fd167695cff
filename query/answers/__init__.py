"""What is answered of the rays that satisfy a criterion."""
