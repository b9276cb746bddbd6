-- The stations of the fleet, each with the figures of its last sign of life.

CREATE TABLE isomark.station (
    name text PRIMARY KEY CHECK (char_length(name) BETWEEN 1 AND 100),
    -- The login that first used the name; no other login may.
    login name NOT NULL,
    -- One run of the program.
    process text NOT NULL CHECK (char_length(process) BETWEEN 1 AND 64),
    program text NOT NULL CHECK (char_length(program) BETWEEN 1 AND 100),
    since timestamptz NOT NULL,
    beat timestamptz NOT NULL,
    -- False after an orderly end.
    runs boolean NOT NULL,
    waiting bigint NOT NULL CHECK (waiting >= 0),
    delivered bigint NOT NULL CHECK (delivered >= 0),
    learned bigint NOT NULL CHECK (learned >= 0),
    rejected bigint NOT NULL CHECK (rejected >= 0),
    outdated bigint NOT NULL CHECK (outdated >= 0),
    uncertain bigint NOT NULL CHECK (uncertain >= 0),
    trouble text CHECK (char_length(trouble) <= 2000)
);

-- Notes that a station is alive. Gives the process that used the name before.
CREATE FUNCTION isomark.beat(
    its_name text, its_process text, its_program text, it_runs boolean,
    its_waiting bigint, its_delivered bigint, its_learned bigint, its_rejected bigint, its_outdated bigint,
    its_uncertain bigint, its_trouble text
) RETURNS text LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    known isomark.station;
BEGIN
    -- Two stations that are new at the same time do not both find an empty place.
    INSERT INTO isomark.station VALUES (
        its_name, session_user, its_process, its_program, now(), now(), it_runs,
        its_waiting, its_delivered, its_learned, its_rejected, its_outdated, its_uncertain, its_trouble
    ) ON CONFLICT (name) DO NOTHING;
    SELECT * INTO STRICT known FROM isomark.station WHERE name = its_name FOR UPDATE;
    IF known.login <> session_user THEN
        RAISE insufficient_privilege USING MESSAGE =
            format('the station name "%s" belongs to the login "%s"', its_name, known.login);
    END IF;
    UPDATE isomark.station SET
        process = its_process, program = its_program, beat = now(), runs = it_runs,
        since = CASE WHEN process = its_process THEN since ELSE now() END,
        waiting = its_waiting, delivered = its_delivered, learned = its_learned, rejected = its_rejected,
        outdated = its_outdated, uncertain = its_uncertain, trouble = its_trouble
    WHERE name = its_name;
    RETURN known.process;
END $$;
