/* --- always --- */
/* Every input as a number: physics go on where nothing was learned, and processes say by their deviation how far they
   are to be believed there. */
static unsigned @NAME_taken(const real *last, const real *input, real *in)
{
    unsigned flags = 0;
    int i;
    for (i = 0; i < @UPPER_INPUTS; ++i) {
        in[i] = input[i];
        if (!is_number(in[i])) {
            flags |= @UPPER_NOT_A_NUMBER;
            in[i] = last ? last[i] : R(0.5) * (@NAME_low[i] + @NAME_high[i]);
        }
@RANGED    }
    return flags;
}

/* Every command as a number within its limit. */
static unsigned @NAME_limited(real *command)
{
    unsigned flags = 0;
    int j;
    for (j = 0; j < @UPPER_COMMANDS; ++j) {
        if (!is_number(command[j])) {
            flags |= @UPPER_NO_ANSWER;
            command[j] = R(0.0);
        }
        if (command[j] > @NAME_most[j] || command[j] < @NAME_least[j])
            flags |= @UPPER_LIMITED;
        command[j] = command[j] > @NAME_most[j] ? @NAME_most[j] : command[j];
        command[j] = command[j] < @NAME_least[j] ? @NAME_least[j] : command[j];
    }
    return flags;
}

@BLENDEDvoid @NAME_init(@NAME_state *state)
{
    int i;
    for (i = 0; i < @UPPER_INPUTS; ++i)
        state->last[i] = R(0.5) * (@NAME_low[i] + @NAME_high[i]);
@FORGET}

unsigned @NAME_mean(@NAME_state *state, const @NAME_real *input, @NAME_real *command)
{
    real in[@UPPER_INPUTS];
@OWN    unsigned flags = @NAME_taken(state->last, input, in);
    memcpy(state->last, in, sizeof in);
    @NAME_answer(in, @MEMORY, RUN, command@SPARE);
@BLEND    return flags | @NAME_limited(command);
}

unsigned @NAME_instant(const @NAME_real *input, @NAME_real *command)
{
    real in[@UPPER_INPUTS], memory[@MEMORIES] = {R(0.0)};
@OWN    unsigned flags = @NAME_taken(0, input, in);
    @NAME_answer(in, memory, INSTANT, command@SPARE);
@BLEND    return flags | @NAME_limited(command);
}

unsigned @NAME_gravity(const @NAME_real *input, @NAME_real *command)
{
    static const int rates[@UPPER_INPUTS] = {@RATES};
    real in[@UPPER_INPUTS], memory[@MEMORIES] = {R(0.0)}, still[@UPPER_INPUTS];
@OWN    unsigned flags;
    int i;
    for (i = 0; i < @UPPER_INPUTS; ++i)
        still[i] = rates[i] ? R(0.0) : input[i];
    flags = @NAME_taken(0, still, in);
    @NAME_answer(in, memory, STILL, command@SPARE);
@BLEND    return flags | @NAME_limited(command);
}

/* --- blended --- */
/* Commands blended with what is safe, by what is unknown of them: their variance without noise. */
static unsigned @NAME_blended(real *command, const real *variance, const real *safe, const real *noise)
{
    static const real full[@UPPER_COMMANDS] = {@FULL}; /* so much may be unknown under full trust */
    static const real span[@UPPER_COMMANDS] = {@SPANS}; /* from there to none */
    static const real known[@UPPER_COMMANDS] = {@KNOWN}; /* more is unknown outside of what was learned */
    unsigned flags = 0;
    int j;
    for (j = 0; j < @UPPER_COMMANDS; ++j) {
        const real unknown = variance[j] - noise[j];
        const real s = (unknown - full[j]) / span[j];
        const int believed = is_number(unknown) && s < R(1.0);
        if (!is_number(unknown) || unknown > known[j])
            flags |= @UPPER_UNTRAINED;
        if (!believed) {
            flags |= @UPPER_FAR;
            command[j] = safe[j];
        } else if (s > R(0.0)) {
            const real trust = R(1.0) - s * s * s * (R(10.0) - R(15.0) * s + R(6.0) * s * s);
            command[j] = safe[j] + trust * (command[j] - safe[j]);
        }
    }
    return flags;
}

/* --- variance --- */
unsigned @NAME_predict(@NAME_state *state, const @NAME_real *input, @NAME_real *command, @NAME_real *variance)
{
    real in[@UPPER_INPUTS];
@KEPT    unsigned flags = @NAME_taken(state->last, input, in);
    memcpy(state->last, in, sizeof in);
    @NAME_answer(in, @MEMORY, RUN, command, variance@BESIDE);
@BLEND@WIDTHS    return flags | @NAME_limited(command);
}
