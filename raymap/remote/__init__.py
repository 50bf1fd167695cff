"""Maps and services on other machines: addresses, object storage, the client, executors."""
