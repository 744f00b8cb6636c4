/* --- always --- */
/* Every input as a number within its range. */
static unsigned @NAME_taken(const real *last, const real *input, real *in)
{
    unsigned flags = 0;
    int i;
    for (i = 0; i < @UPPER_INPUTS; ++i) {
        real value = input[i];
        if (!is_number(value)) {
            flags |= @UPPER_NOT_A_NUMBER;
            value = last ? last[i] : R(0.5) * (@NAME_low[i] + @NAME_high[i]);
        }
        if (value < @NAME_trained_low[i] || value > @NAME_trained_high[i])
            flags |= @UPPER_UNTRAINED;
        if (value < @NAME_low[i] || value > @NAME_high[i])
            flags |= @UPPER_CLAMPED;
        value = value < @NAME_low[i] ? @NAME_low[i] : value;
        in[i] = value > @NAME_high[i] ? @NAME_high[i] : value;
    }
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

void @NAME_init(@NAME_state *state)
{
    int i;
    for (i = 0; i < @UPPER_INPUTS; ++i)
        state->last[i] = R(0.5) * (@NAME_low[i] + @NAME_high[i]);
@FORGET}

unsigned @NAME_mean(@NAME_state *state, const @NAME_real *input, @NAME_real *command)
{
    real in[@UPPER_INPUTS];
@SAFE    const unsigned flags = @NAME_taken(state->last, input, in);
    memcpy(state->last, in, sizeof in);
    @NAME_answer(in, @MEMORY, 0, command@NONE);
    return flags | @NAME_limited(command);
}

unsigned @NAME_gravity(const @NAME_real *input, @NAME_real *command)
{
    static const int rates[@UPPER_INPUTS] = {@RATES};
    real in[@UPPER_INPUTS], memory[@MEMORIES] = {R(0.0)}, still[@UPPER_INPUTS];
@SAFE    unsigned flags;
    int i;
    for (i = 0; i < @UPPER_INPUTS; ++i)
        still[i] = rates[i] ? R(0.5) * (@NAME_trained_low[i] + @NAME_trained_high[i]) : input[i];
    flags = @NAME_taken(0, still, in);
    for (i = 0; i < @UPPER_INPUTS; ++i)
        in[i] = rates[i] ? R(0.0) : in[i];
    @NAME_answer(in, memory, 1, command@NONE);
    return flags | @NAME_limited(command);
}

/* --- variance --- */
unsigned @NAME_predict(@NAME_state *state, const @NAME_real *input, @NAME_real *command, @NAME_real *variance)
{
    real in[@UPPER_INPUTS];
@SAFE    const unsigned flags = @NAME_taken(state->last, input, in);
    memcpy(state->last, in, sizeof in);
    @NAME_answer(in, @MEMORY, 0, command, variance@KEPT);
    return flags | @NAME_limited(command);
}

/* --- fade --- */
unsigned @NAME_faded(@NAME_state *state, const @NAME_real *input, @NAME_real *command, @NAME_real *variance)
{
    static const real prior[@UPPER_COMMANDS] = {@PRIOR};
    real in[@UPPER_INPUTS], safe[@UPPER_COMMANDS], noise[@UPPER_COMMANDS];
    const unsigned flags = @NAME_taken(state->last, input, in);
    int j;
    memcpy(state->last, in, sizeof in);
    @NAME_answer(in, @MEMORY, 0, command, variance, safe, noise);
    for (j = 0; j < @UPPER_COMMANDS; ++j) {
        const real beyond = ((variance[j] - noise[j]) * prior[j] - @TRUSTED) / @SPAN;
        const real low = beyond > R(0.0) ? beyond : R(0.0), s = low < R(1.0) ? low : R(1.0);
        const real trust = R(1.0) - s * s * s * (R(10.0) - R(15.0) * s + R(6.0) * s * s);
        command[j] = safe[j] + trust * (command[j] - safe[j]);
    }
    return flags | @NAME_limited(command);
}
