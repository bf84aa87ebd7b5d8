"""What is flown: the scenarios, their records, and the configuration a daemon needs for each."""
