!> Watches whether a run stays within the limits of the model: small deflections in each body's frame, spins well below
!> the first bending frequency unless stiffening is on, motion that the mesh or the modes can carry.
module validity
  use kinds, only: wp, pi
  use axial_loads, only: axial_force_of, axial_watch, begin_axial, critical_shares, note_axial, pressed, pulled
  use banded, only: band_factor, band_solve
  use beam_element, only: geometric_stiffness
  use body, only: body_model
  use elastic_operators, only: factor_entries, mass_product
  use evaluation_results, only: evaluation
  use layer_limits, only: body_sentence, stiff_core, thick_layers, told
  use mechanism, only: mechanism_model
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: validity_watch, bend_to_limit, limits_of_beams, lowest_frequency

  real(wp), parameter :: large_deflection = 0.1_wp   !! of the body's length [-]
  real(wp), parameter :: large_angle = 0.2_wp        !! of a section in its frame, of the shear of a core [rad]
  real(wp), parameter :: fast_spin = 1.0_wp/3.0_wp   !! of the lowest bending frequency [-]
  real(wp), parameter :: large_load = 1.0_wp/3.0_wp  !! along a body, of its critical load [-]
  real(wp), parameter :: shear_ratio = 3.12_wp       !! E/(kappa G) of a rectangle at Poisson's ratio 0.3 [-]
  real(wp), parameter :: least_vibration = 1.0e-9_wp !! amplitude of a vibration, of the deflection; below it is rounding [-]
  real(wp), parameter :: part_period = 1/(1 - 1/(4*pi))   !! mean squares over a period and a part of the next one err by this [-]

  !> Figures of every body: its largest deflection [m], section rotation [rad] and spin [rad/s], the sums of squared elastic
  !> rates and accelerations, whose ratio is the squared frequency of the elastic motion, the largest angle of a core [rad], and
  !> those of second order: shortening [m], work of axial forces on it and strain energy in bending [J].
  integer, parameter :: deflection = 1, rotation = 2, spin = 3, rates = 4, accelerations = 5, slip = 6
  integer, parameter :: shortening = 7, axial_work = 8, bending = 9

  !> The watch.
  type :: validity_watch
    real(wp), allocatable :: figures(:, :)           !! (9, nb), part of a checkpoint [m, rad, rad/s; m2/s2, m2/s4; rad; m, J, J]
    type(axial_watch) :: axial
    real(wp), allocatable :: weight(:)               !! (nq) of each elastic rate: rotations count times half an element [m2]
  contains
    procedure :: begin
    procedure :: note
    procedure :: warnings
    procedure :: too_coarse
    procedure :: elastic_frequency
    procedure :: left_out
  end type validity_watch

contains

  !> Starts the watch.
  subroutine begin(self, m)
    class(validity_watch), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: b
    if (allocated(self%figures)) deallocate (self%figures)
    allocate (self%figures(9, size(m%s%bodies)), source=0.0_wp)
    call begin_axial(self%axial, m)
    self%weight = [(1.0_wp, b=1, m%s%nq)]
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b), i => m%s%qo(b) + 3)
        if (.not. body%flexible) cycle
        where (body%basis%rotation) self%weight(i + 1:i + body%nf) = (0.5_wp*body%elements(1)%length)**2
      end associate
    end do
  end subroutine begin

  !> Adds an evaluated state to the figures.
  subroutine note(self, m, ev, q, v)
    class(validity_watch), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:), v(:)               !! (nq) [m, rad], [m/s, rad/s]
    real(wp) :: u(3)
    integer :: b, k, i, n
    call note_axial(self%axial, m, ev, v)
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b), f => self%figures(:, b))
        if (.not. body%flexible) cycle
        i = m%s%qo(b) + 3
        n = body%nf
        do k = 1, body%nn
          u = body%displacement(k, q(i + 1:i + n))
          f(deflection) = max(f(deflection), hypot(u(1), u(2)))
          f(rotation) = max(f(rotation), abs(u(3)))
        end do
        f(spin) = max(f(spin), abs(v(i)))
        if (.not. body%stiffening) call note_second_order(body, q(i + 1:i + n), ev%elastic(b)%d, self%axial, b, f)
        if (size(body%dof, 1) > 3) f(slip) = max(f(slip), largest_slip(body, q(i + 1:i + n)))
        do k = 1, n
          f(rates) = f(rates) + self%weight(i + k)*v(i + k)**2
          f(accelerations) = f(accelerations) + self%weight(i + k)*ev%a(i + k)**2
        end do
      end associate
    end do
  end subroutine note

  !> Adds the shortening of a bent body, and what axial forces do on it.
  pure subroutine note_second_order(body, q, d, axial, b, f)
    type(body_model), intent(in) :: body
    real(wp), intent(in) :: q(:)                     !! (nf) [m, rad]
    real(wp), intent(in), contiguous :: d(:, :)      !! rows of its elements, as the evaluation has them [m, rad]
    type(axial_watch), intent(in) :: axial
    integer, intent(in) :: b                         !! its index
    real(wp), intent(inout) :: f(:)                  !! (9) figures of the body [m, rad, rad/s; m2/s2, m2/s4; rad; m, J, J]
    real(wp) :: a(6), k(6, 6), parts(3)              ! [m, rad], [1/m, -, m], [J]
    real(wp) :: shorter, whole, work                 ! [m], [m], [J]
    integer :: e, j
    whole = 0.0_wp
    work = 0.0_wp
    do e = 1, body%ne
      a(:3) = body%displacement(body%en(1, e), q)
      a(4:) = body%displacement(body%en(2, e), q)
      k = geometric_stiffness(body%elements(e), 1.0_wp)
      shorter = 0.0_wp
      do j = 1, 6                                    ! a product of functions would allocate in each row
        shorter = shorter + 0.5_wp*a(j)*dot_product(k(:, j), a)
      end do
      whole = whole + shorter
      work = work + axial_force_of(axial, b, e)*shorter
    end do
    parts = body%basis%strain_parts(body, q, d)
    f(shortening) = max(f(shortening), whole)
    f(axial_work) = max(f(axial_work), abs(work))
    f(bending) = max(f(bending), 0.5_wp*sum(parts(2:)))
  end subroutine note_second_order

  !> About what the linear model of a body leaves out of its motion, over its largest deflection: the shortening that goes with it,
  !> the third order of its turns, and what axial forces take or give of its bending stiffness.
  pure real(wp) function left_out(self, m, b) result(share)   ! [-]
    class(validity_watch), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b                         !! index of the body
    share = 0.0_wp
    associate (f => self%figures(:, b))
      if (.not. f(deflection) > least_vibration*m%s%bodies(b)%length) return
      share = f(shortening)/f(deflection) + f(rotation)**2/6
      if (f(bending) > 0.0_wp) share = share + f(axial_work)/f(bending)
    end associate
  end function left_out

  !> The largest angle of a core at a node.
  pure real(wp) function largest_slip(body, q) result(largest)   ! [rad]
    type(body_model), intent(in) :: body
    real(wp), intent(in) :: q(:)                     !! (nf) [m, rad]
    real(wp) :: a(size(body%edof, 1))                ! [m, rad]
    integer :: e
    largest = 0.0_wp
    do e = 1, body%ne
      a = body%basis%element_coordinates(body, e, q)
      largest = max(largest, maxval(abs(a(7::3))), maxval(abs(a(8::3))))
    end do
  end function largest_slip

  !> One sentence for each limit that a body passed.
  function warnings(self, m, ev, stage) result(text)
    class(validity_watch), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    character(*), intent(in) :: stage               !! words that go before the body: in which analysis; empty: the transient
    character(:), allocatable :: text
    real(wp) :: first                                ! [rad/s]
    real(wp) :: loads(2)                             ! over the critical load [-]
    integer :: b
    text = ''
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b), f => self%figures(:, b))
        if (.not. body%flexible) cycle
        if (f(deflection) > large_deflection*body%length) call say(body, 'deflects by', f(deflection)/body%length*100, &
          '% of its length: beyond about 10 % the linear floating frame no longer holds (more bodies, each with its own frame)')
        if (f(rotation) > large_angle) call say(body, 'turns a section by', f(rotation), &
                                            'rad in its frame: beyond about 0.2 rad the linear floating frame no longer holds')
        if (f(slip) > large_angle) call say(body, 'shears a core by', f(slip), 'rad: beyond about 0.2 rad no core is '// &
                                            'linear')
        first = huge(1.0_wp)
        if (.not. body%stiffening .and. f(spin) > 0.0_wp) then
          first = lowest_frequency(body)
          if (f(spin) > fast_spin*first) call say(body, 'spins at', f(spin)/first, 'of its lowest bending frequency without '// &
            'stiffening=.true.: the linear strain misses the centrifugal stiffening')
        end if
        loads = critical_shares(self%axial, m, ev, b)
        if (loads(pressed) > large_load) call say(body, 'is pressed along its axis by', loads(pressed), 'of its critical load '// &
          'without stiffening=.true.: the linear strain misses how pressure softens its bending (or more bodies, each with its '// &
          'own frame)')
        if (loads(pulled) > large_load .and. .not. f(spin) > fast_spin*first) call say(body, 'is pulled along its axis by', &
          loads(pulled), 'of what would buckle it as pressure, without stiffening=.true.: the linear strain misses how tension '// &
          'stiffens its bending (or more bodies, each with its own frame)')
      end associate
    end do
  contains
    !> Adds a sentence.
    subroutine say(body, what, x, rest)
      type(body_model), intent(in) :: body
      character(*), intent(in) :: what, rest
      real(wp), intent(in) :: x   !! figure of the sentence [-], [rad] or [rad/s]
      text = text//body_sentence(body, stage, what, x, rest)
    end subroutine say
  end function warnings

  !> Warnings of bodies that move faster than their coordinates can follow: the model holds, its mesh or modes are too few.
  function too_coarse(self, m, ev) result(text)
    class(validity_watch), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    character(:), allocatable :: text
    real(wp) :: highest, moving                      ! [rad/s]
    integer :: b
    text = ''
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b))
        if (.not. body%flexible) cycle
        highest = part_period*body%basis%top_frequency
        if (ev%t*highest < 2*pi) cycle       ! before one period a motion that starts from rest looks too fast
        moving = self%elastic_frequency(m, b)
        if (moving > highest) text = text//body_sentence(body, '', 'moves elastically at', moving, 'rad/s, faster than its '// &
          'mesh or modes can carry: its elastic coordinates and accelerations are not converged (more elements or modes)')
      end associate
    end do
  end function too_coarse

  !> Frequency of a flexible body's elastic motion, from the mean squares of rates and accelerations; 0 where only rounding moves,
  !> as in an equilibrium.
  pure real(wp) function elastic_frequency(self, m, b) result(moving)   ! [rad/s]
    class(validity_watch), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b                         !! index of the body
    real(wp) :: bent                                 ! [m]
    associate (body => m%s%bodies(b), f => self%figures(:, b))
      bent = max(f(deflection), f(rotation)*body%length)
      moving = 0.0_wp
      if (f(rates) > least_vibration*sqrt(f(accelerations))*bent/body%basis%unit .and. bent > 1.0e-13_wp*body%length) then
        moving = sqrt(f(accelerations)/f(rates))
      end if
    end associate
  end function elastic_frequency

  !> Warnings of beams that are not slender, and of layers for which their theory does not hold, in motions up to a frequency.
  function limits_of_beams(m, fastest) result(text)
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: fastest                  !! of modes and responses [rad/s]
    character(:), allocatable :: text
    real(wp) :: shear                                ! [-]
    logical :: reduced                               ! to modes
    integer :: b
    text = ''
    do b = 1, size(m%s%bodies)
      associate (body => m%s%bodies(b))
        if (.not. body%flexible .or. m%prototype(b) /= b) cycle
        if (body%layers%shown) then
          text = text//with_others(stiff_core(body))//with_others(thick_layers(body, max(fastest, frequency_in_use(body))))
          cycle
        end if
        shear = shear_correction(body)
        reduced = body%basis%reduced_from > 0
        if (shear > told) text = text//with_others(body_sentence(body, '', 'is so short and thick that shear and rotary '// &
          'inertia, which sections without shear=.true. lack, would lower its '//either('highest kept', 'lowest', reduced .and. &
          body%nf > 1)//' frequency by', 100*shear, '%'//either('', ', and higher ones by more', reduced)))
      end associate
    end do
  contains
    !> A sentence of body b that holds for others of its kind, too.
    function with_others(sentence) result(more)
      character(*), intent(in) :: sentence
      character(:), allocatable :: more
      integer :: others, at
      others = count(m%prototype == b) - 1
      at = index(sentence, '" ')
      more = sentence
      if (others > 0 .and. at > 0) more = sentence(:at)//' (with '//to_text(others)//' like it)'//sentence(at + 1:)
    end function with_others
  end function limits_of_beams

  !> Adds the body's lowest mode to its elastic coordinates, as large as the linear frame holds.
  subroutine bend_to_limit(b, q)
    type(body_model), intent(in) :: b
    real(wp), intent(inout) :: q(:)                  !! (nf) [m], [rad]
    real(wp), allocatable :: x(:)
    real(wp) :: omega, u(3), most
    integer :: k
    omega = lowest_frequency(b, x)
    if (.not. omega < huge(1.0_wp)) return
    most = 0.0_wp
    do k = 1, b%nn
      u = b%displacement(k, x)
      most = max(most, hypot(u(1), u(2))/(large_deflection*b%length), abs(u(3))/large_angle)
    end do
    if (most > 0.0_wp) q = q + x/most
  end subroutine bend_to_limit

  !> Lowest frequency under the reference conditions, and its mode, by inverse iteration; huge where there is none [rad/s].
  function lowest_frequency(b, shape) result(omega)
    type(body_model), intent(in) :: b
    real(wp), allocatable, intent(out), optional :: shape(:)   !! (nf) that mode, of any size [m, rad]
    real(wp) :: omega
    type(band_factor) :: factor
    real(wp), dimension(b%nf) :: x, mx, force
    real(wp) :: work(2, b%nf)
    integer :: k, pass
    logical :: bad
    omega = huge(1.0_wp)
    call factor_entries(b%op%symmetric, b%op%k, factor, bad)
    if (bad) return
    x = [(1.0_wp + 0.3_wp*sin(1.7_wp*k), k=1, b%nf)]
    do pass = 1, 30
      call mass_product(b%op, x, mx)
      force = mx
      x = mx
      call band_solve(factor, b%nf, x, work)
      call mass_product(b%op, x, mx)
      omega = sqrt(dot_product(x, force)/dot_product(x, mx))
      x = x/sqrt(dot_product(x, mx))
    end do
    if (present(shape)) shape = x
  end function lowest_frequency

  !> The highest frequency in bending that is kept, or of a mesh the lowest, which is surely in use.
  real(wp) function frequency_in_use(b) result(omega)   ! [rad/s]
    type(body_model), intent(in) :: b
    omega = max(lowest_frequency(b), b%basis%highest_bending)
  end function frequency_in_use

  !> Part by which shear and rotary inertia would lower the frequency in use: Timoshenko's first correction
  !> k2 r2 (1 + E/(kappa G))/2 of a wave of that frequency, k2 r2 = omega r/sqrt(E/rho), averaged over the length;
  !> 1 - 1/sqrt(1 + 2 x) where it is not small.
  function shear_correction(b) result(share)
    type(body_model), intent(in) :: b
    real(wp) :: share                                !! of the frequency [-]
    share = frequency_in_use(b)
    associate (g => b%elements)
      share = 0.5_wp*(1 + shear_ratio)*share*sum(sqrt(g%ei_l*g%mass)/g%ea_l)/sum(g%length)
    end associate
    share = 1 - 1/sqrt(1 + 2*share)
  end function shear_correction
end module validity
