"""The one room that sees every stage; each module is one job a user asks for."""
