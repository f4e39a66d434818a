"""What a build makes: chunks of work, done anywhere; folders, whole or not at all."""
