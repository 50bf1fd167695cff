"""What is asked and answered: requests, recordings, questions, streams, applications."""
