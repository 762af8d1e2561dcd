"""Pure mathematics: functions of numbers and arrays that import nothing else of the package."""
