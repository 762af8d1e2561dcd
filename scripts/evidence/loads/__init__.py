"""Cases under weight and pressure with their exact solutions."""
