"""Views: tables and pages of any contents, and the renderers that show them. No document is known here."""
