"""The flexible manipulator of Moberg, Öhr and Gunnarsson (2008) as an FMI 2.0 co-simulation FMU."""
