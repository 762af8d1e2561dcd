"""What the command shows: tables, messages, progress, and streams that may close."""
