"""Who asks: tokens, rights, how a call is let in."""
