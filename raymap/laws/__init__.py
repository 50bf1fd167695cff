"""What light does at surfaces and in media, in the forms in which maps store it: a file a form."""
