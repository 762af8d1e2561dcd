"""One paper reproduced: figures, numbers and claims."""
