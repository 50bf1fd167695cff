"""The application in the browser: server, session, what the page may ask."""
