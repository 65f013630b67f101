!> The energy balance of a transient: kinetic + potential + dissipated - work - start, the residual, is zero for exact
!> integration. The residual is compared with
!> - the largest swing of a kind of energy, which does not depend on where the scene stands;
!> - the kinetic energy, where no other kind moves. A force that turns a velocity moves kinetic energy from one direction to the
!>   other, which a method integrates as it does a vibration. In a steady turn nothing else swings;
!> - for each flexible body, the energy that its deformation took up and gave back. Large rigid motion may hide errors of it.
!> Errors add up in the residual: each step counts, whether a row is written after it or not.
module energy_balance
  use kinds, only: wp, ip
  use archive, only: value_archive
  use column_ranges, only: column_range
  use energy, only: energies
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use projection, only: violations
  implicit none (type, external)
  private

  !> Residual of the energy that moved, error of a column of its range, gap of a joint of the scene's size, beyond which results
  !> cannot be trusted [-].
  real(wp), parameter, public :: distrusted = 1.0e-2_wp

  !> The balance so far. Energies are kinetic, potential, dissipated and work, in this order.
  type, public :: balance_watch
    real(wp) :: row(9) = 0.0_wp               !! of energy.txt: 4 energies, residual [J], violations [m], [m/s], losses [J]
    integer :: columns = 7                    !! of the row in use: what stops, then what friction dissipated follow where any can
    real(wp) :: start(2) = 0.0_wp             !! kinetic and potential energy at t = 0 [J]
    real(wp) :: least = 0.0_wp                !! smaller energies are negligible [J]
    real(wp) :: reachable = 0.0_wp            !! by the forces of the start until the first row [J]
    real(wp) :: largest_balanced = 0.0_wp     !! largest energy of the rows whose balance is not lost [J]
    type(column_range) :: kinds               !! smallest and largest of the four energies [J]
    real(wp), allocatable :: along(:)         !! (2 nb + 2) kinetic energy along x, y: of the mass centre, of bodies beside it [J]
    type(column_range) :: along_range         !! smallest and largest of these [J]
    real(wp), allocatable :: strain(:)        !! (nb) energy stored in the deformation of each body [J]
    type(column_range) :: strain_range        !! smallest and largest of these [J]
    integer(ip) :: steps = 0                  !! that the last row took
    real(wp) :: largest_residual = 0.0_wp     !! [J]
    real(wp) :: violation(2) = 0.0_wp         !! largest, of positions [m] and of velocities [m/s]
  contains
    procedure :: begin
    procedure :: read
    procedure :: diverged
    procedure :: count
    procedure :: moved
    procedure :: floor => floor_of
    procedure :: exchanged
    procedure :: share
    procedure :: body_share
    procedure :: exchange
  end type balance_watch

contains

  !> Before the first row.
  subroutine begin(self, m, t_end)
    class(balance_watch), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: t_end             !! length of the run [s]
    integer :: nb
    nb = size(m%s%bodies)
    self%least = sum(m%s%bodies%mass)*(1.0e-6_wp*m%s%size/t_end)**2   ! a millionth of the scene's size in the run
    allocate (self%along(2*nb + 2), self%strain(nb), source=0.0_wp)
    self%kinds = column_range(spread(0.0_wp, 1, 4), spread(0.0_wp, 1, 4))    ! for a run without a row
    self%along_range = column_range(self%along, self%along)
    self%strain_range = column_range(self%strain, self%strain)
  end subroutine begin

  !> Reads the energies and violations of the state of an evaluation; first: the one at t = 0.
  subroutine read(self, m, ev, y, first)
    class(balance_watch), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: y(:)  !! (ny) layout in `scene_model` [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: first
    associate (nq => m%s%nq, nz => m%s%nz, nzd => m%s%nzd, x => self%row)
      call energies(m, ev, y(1:nq), y(nq + 1:2*nq), y(2*nq + 1:2*nq + nz), y(2*nq + nz + 1:2*nq + nz + nzd), x(1), x(2), &
                    self%strain)
      call violations(m, ev, x(6), x(7))
      x(3:4) = y(2*nq + nz + nzd + 1:2*nq + nz + nzd + 2)
      associate (each => y(2*nq + nz + nzd + 3:2*nq + nz + nzd + 2 + m%s%elements), stops => m%s%stops, n => size(m%s%switching))
        self%columns = 7 + merge(1, 0, stops > 0) + merge(1, 0, size(each) > n)
        x(9) = sum(each(n + 1:))
        x(8) = merge(sum(each(:stops)), x(9), stops > 0)
      end associate
      call kinetic_by_direction(m, ev, y(nq + 1:2*nq), self%along)
      if (first) then                         ! impacts may have come before it
        self%start = [x(1) + x(3) - x(4), x(2)]
        self%kinds = column_range([x(1:2), 0.0_wp, 0.0_wp], [x(1:2), 0.0_wp, 0.0_wp])
        call self%kinds%note([self%start, 0.0_wp, 0.0_wp])
        call self%kinds%note(x(1:4))
        self%along_range = column_range(self%along, self%along)
        self%strain_range = column_range(self%strain, self%strain)
      end if
      x(5) = x(1) + x(2) + x(3) - x(4) - sum(self%start)
    end associate
  end subroutine read

  !> Kinetic energy along x and y of the scene's mass centre, and of each body's mass centre as seen from there: it is the same on
  !> the ground and in a vehicle. Elastic rates do not count.
  pure subroutine kinetic_by_direction(m, ev, v, along)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: v(:)              !! (nq) [m/s, rad/s]
    real(wp), intent(out) :: along(2, 0:size(m%s%bodies))   !! [J]
    real(wp) :: momentum(2), mass             ! [kg m/s], [kg]
    integer :: b
    momentum = 0.0_wp
    mass = 0.0_wp
    do b = 1, size(m%s%bodies)
      associate (x => along(:, b), p => ev%frame%first_moment(:, b), c => ev%frame%cos(b), s => ev%frame%sin(b), i => m%s%qo(b))
        x(1) = v(i + 1) - v(i + 3)*(s*p(1) + c*p(2))/m%s%bodies(b)%mass      ! velocities first
        x(2) = v(i + 2) + v(i + 3)*(c*p(1) - s*p(2))/m%s%bodies(b)%mass
        momentum = momentum + m%s%bodies(b)%mass*x
        mass = mass + m%s%bodies(b)%mass
      end associate
    end do
    do b = 1, size(m%s%bodies)
      along(:, b) = 0.5_wp*m%s%bodies(b)%mass*(along(:, b) - momentum/mass)**2
    end do
    along(:, 0) = 0.5_wp*momentum**2/mass
  end subroutine kinetic_by_direction

  !> Whether the balance just read shows that the solution is lost: the residual is most of the present energy, and far above all
  !> energies that the run had while its balance was closed.
  function diverged(self) result(yes)
    class(balance_watch), intent(inout) :: self
    logical :: yes
    real(wp), parameter :: most_of = 0.5_wp, far_above = 1.0e3_wp   !! [-]
    real(wp) :: present
    associate (x => self%row)
      present = max(x(1), abs(x(2) - self%start(2)), abs(x(3)), abs(x(4)))
      yes = abs(x(5)) > most_of*present
      if (.not. yes) self%largest_balanced = max(self%largest_balanced, present)
      if (yes) yes = abs(x(5)) > far_above*max(self%largest_balanced, self%least, self%reachable, epsilon(1.0_wp)*abs(x(2)))
    end associate
  end function diverged

  !> Counts the row just read.
  pure subroutine count(self, steps)
    class(balance_watch), intent(inout) :: self
    integer(ip), intent(in) :: steps          !! taken so far
    self%steps = steps
    call self%kinds%note(self%row(1:4))
    call self%along_range%note(self%along)
    call self%strain_range%note(self%strain)
    self%largest_residual = max(self%largest_residual, abs(self%row(5)))
    self%violation = max(self%violation, self%row(6:7))
  end subroutine count

  !> Energy that moved: the largest swing of a kind; zero where it is negligible or rounding. Kinetic energy changes by exchange
  !> with the other kinds: where these are constant, it should be constant too, and its swing is an error [J].
  pure function moved(self) result(energy)
    class(balance_watch), intent(in) :: self
    real(wp) :: energy
    if (self%exchanged()) then
      associate (turns => self%along_range%high - self%along_range%low)
        energy = maxval([self%kinds%high - self%kinds%low, sum(turns(1::2)), sum(turns(2::2))])
      end associate
    else
      energy = self%kinds%high(1)
    end if
    if (.not. energy > floor_of(self)) energy = 0.0_wp
  end function moved

  !> Whether kinetic energy is exchanged with another kind.
  pure logical function exchanged(self)
    class(balance_watch), intent(in) :: self
    exchanged = maxval(self%kinds%high(2:4) - self%kinds%low(2:4)) > floor_of(self)
  end function exchanged

  !> Smaller energies are not judged: they are negligible, or of the size of rounding [J].
  pure function floor_of(self) result(energy)
    class(balance_watch), intent(in) :: self
    real(wp) :: energy
    real(wp) :: rounding                      ! of energies, and of the work summed in all steps [-]
    rounding = (1.0e4_wp + real(self%steps, wp))*epsilon(1.0_wp)
    energy = max(self%least, rounding*maxval(abs([self%kinds%low, self%kinds%high])))
  end function floor_of

  !> Largest residual over the energy that moved; 0 where none did [-].
  pure function share(self) result(x)
    class(balance_watch), intent(in) :: self
    real(wp) :: x
    x = 0.0_wp
    if (self%moved() > 0.0_wp) x = self%largest_residual/self%moved()
  end function share

  !> The body with the largest residual over the energy that its deformation took up and gave back; body = 0 where all stored
  !> energies are negligible.
  pure subroutine body_share(self, body, x, energy)
    class(balance_watch), intent(in) :: self
    integer, intent(out) :: body
    real(wp), intent(out) :: x                !! [-]
    real(wp), intent(out) :: energy           !! that the body's deformation exchanged [J]
    real(wp) :: swing
    integer :: b
    body = 0
    x = 0.0_wp
    energy = huge(1.0_wp)
    do b = 1, size(self%strain)
      swing = self%strain_range%high(b) - self%strain_range%low(b)
      if (.not. swing > floor_of(self) .or. swing >= energy) cycle
      body = b
      energy = swing
      x = self%largest_residual/swing
    end do
  end subroutine body_share

  !> Saves or restores the balance.
  subroutine exchange(self, a)
    class(balance_watch), intent(inout) :: self
    type(value_archive), intent(inout) :: a
    call a%exchange(self%reachable, self%largest_balanced)
    call a%exchange(self%row, self%start)
    call self%kinds%exchange(a)
    call self%along_range%exchange(a)
    call a%exchange(self%steps)
    call self%strain_range%exchange(a)
    call a%exchange(self%largest_residual)
    call a%exchange(self%violation)
  end subroutine exchange
end module energy_balance
