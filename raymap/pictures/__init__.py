"""Pictures and charts as files: formats that trace, query and application write alike."""
