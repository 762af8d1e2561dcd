"""The modal engine: exact motion of a few modes, rigid contact through the omitted flexibility."""
