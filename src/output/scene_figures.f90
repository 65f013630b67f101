!> Where everything of the assembled scene stands, for pictures: frames and nodes of the bodies, the markers of joints, drives,
!> springs, forces and sensors. Written as figures of the summary, one line each; words are not added.
module scene_figures
  use growing_text, only: text_buffer
  use kinds, only: wp
  use deck_records, only: deck, marker_record
  use contact_pair, only: pair_measure
  use measure, only: measure_model
  use mechanism, only: mechanism_model
  use summary_text, only: json_number, summary_record
  use readable_text, only: json_text
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: add_scene

contains

  !> Adds the scene.
  subroutine add_scene(d, m, q, text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) assembled positions [m], [rad]
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: friction
    integer :: k
    call text%open('scene', '{')
    call text%member('size', json_number(m%s%size))
    call text%member('gravity', vector(d%scene%gravity))
    call text%open('bodies', '[')
    do k = 1, size(d%bodies)
      call add_body(k)
    end do
    call text%close()
    call text%open('profiles', '[')
    do k = 1, size(d%profiles)
      call add_profile(k)
    end do
    call text%close()
    call text%open('joints', '[')
    do k = 1, size(d%joints)
      associate (r => d%joints(k))
        friction = ''
        if (max(r%friction, r%friction_static, r%preload, r%preload_static) > 0.0_wp) friction = &
          ', "friction": '//json_number(r%friction)
        call pair(r%name, r%type, r%a, r%b, r%direction, friction//follower(r%profile, r%radius, r%face))
      end associate
    end do
    call text%close()
    call text%open('drives', '[')
    do k = 1, size(d%drives)
      call pair(d%drives(k)%name, d%drives(k)%type, d%drives(k)%a, d%drives(k)%b, d%drives(k)%direction, '')
    end do
    call text%close()
    call text%open('springs', '[')
    do k = 1, size(d%springs)
      call pair(d%springs(k)%name, d%springs(k)%type, d%springs(k)%a, d%springs(k)%b, 0.0_wp, '')
    end do
    call text%close()
    call text%open('stops', '[')
    do k = 1, size(d%stops)
      associate (r => d%stops(k))
        call pair(r%name, r%type, r%a, r%b, r%direction, ', "lower": '//json_number(r%lower)//', "upper": '// &
                  json_number(r%upper)//follower(r%profile, r%radius, r%face))
      end associate
    end do
    call text%close()
    call text%open('forces', '[')
    do k = 1, size(d%forces)
      associate (r => d%forces(k))             ! as where their history is 1
        call text%member('', item(r%name, r%type)//', "at": '//marker(r%marker)//', "force": '//vector([r%fx, r%fy])// &
                         ', "axes": '//json_text(trim(r%axes))//', "moment": '//json_number(r%moment)//', "centre": '// &
                         vector(r%centre)//'}')
      end associate
    end do
    call text%close()
    call text%open('lumps', '[')
    do k = 1, size(d%lumps)
      call text%member('', '{"at": '//marker(d%lumps(k)%marker)//', "mass": '//json_number(d%lumps(k)%mass)//'}')
    end do
    call text%close()
    call text%open('sensors', '[')
    do k = 1, size(d%sensors)
      call text%member('', item(d%sensors(k)%name, d%sensors(k)%quantity)//', "at": '//marker(measured(k))//'}')
    end do
    call text%close()
    call text%close()
  contains
    !> A body: frame, nodes, elements; of a rigid body its mass centre.
    subroutine add_body(k)
      integer, intent(in) :: k                 !! body
      type(text_buffer) :: nodes, elements
      integer :: j
      associate (b => m%s%bodies(k), r => d%bodies(k))
        do j = 1, b%nn
          if (j > 1) call nodes%add(', ')
          call nodes%add(position(marker_record(body=k, node=j)))
        end do
        do j = 1, b%ne
          if (j > 1) call elements%add(', ')
          call elements%add('['//to_text(b%en(1, j))//', '//to_text(b%en(2, j))//']')
        end do
        call text%member('', item(r%name, r%kind)//', "frame": '//vector(q(m%s%qo(k) + 1:m%s%qo(k) + 3))//', "mass": '// &
                         json_number(b%mass)//', "centre": '//position(marker_record(body=k, point=b%i1/b%mass))// &
                         ', "nodes": ['//nodes%all()//'], "elements": ['//elements%all()//']'//layers_of(k)//'}')
      end associate
    end subroutine add_body

    !> A profile that some pair has: the points of its outline, in the axes of the section that carries it.
    subroutine add_profile(number)
      integer, intent(in) :: number            !! profile
      integer :: k
      k = findloc(d%joints%profile, number, 1)
      if (k > 0) then
        call outline(number, m%s%constraints(k)%item%measures(1)%item)
      else
        k = findloc(d%stops%profile, number, 1)
        if (k > 0) call outline(number, m%s%forces(m%s%springs + size(d%forces) + k)%item%measure)
      end if
    end subroutine add_profile

    !> Its line.
    subroutine outline(number, gap)
      integer, intent(in) :: number            !! profile
      class(measure_model), intent(in) :: gap
      real(wp), allocatable :: c(:, :)         ! [m]
      type(text_buffer) :: points
      integer :: k
      select type (gap)
      class is (pair_measure)
        c = gap%profile%outline()
        do k = 1, size(c, 2)
          if (k > 1) call points%add(', ')
          call points%add(vector(c(:, k)))
        end do
        call text%member('', item(d%profiles(number)%name, d%profiles(number)%kind)//', "closed": '// &
                         yes(d%profiles(number)%closed)//', "points": ['//points%all()//']}')
      end select
    end subroutine outline

    !> What follows a profile: its name, and a roller or a face (its angle from the section; null: none).
    function follower(number, radius, face) result(json)
      integer, intent(in) :: number            !! 0: none
      real(wp), intent(in) :: radius           !! [m]
      real(wp), intent(in) :: face             !! [rad]
      character(:), allocatable :: json
      json = ''
      if (number > 0) json = ', "profile": '//json_text(trim(d%profiles(number)%name))//', "radius": '//json_number(radius)// &
        ', "face": '//json_number(face)
    end function follower

    !> The sections of a body of layers, each layer between two heights above the node line, and the section of each element.
    function layers_of(k) result(json)
      integer, intent(in) :: k                 !! body
      character(:), allocatable :: json
      type(text_buffer) :: words
      integer :: j, l
      json = ''
      if (.not. m%s%bodies(k)%layers%shown) return
      call words%add(', "sections": [')
      associate (b => m%s%bodies(k)%layers)
        do j = 1, size(b%sections)
          call words%add(either('[', ', [', j == 1))
          do l = 1, size(b%sections(j)%layers)
            associate (layer => b%sections(j)%layers(l))
              call words%add(either('', ', ', l == 1)//'{"material": '//json_text(trim(m%s%materials(layer%material)))// &
                             ', "from": '//json_number(layer%height - 0.5_wp*layer%thickness)//', "to": '// &
                             json_number(layer%height + 0.5_wp*layer%thickness)//', "core": '//yes(layer%core > 0)// &
                             ', "viscoelastic": '//yes(layer%follows)//'}')
            end associate
          end do
          call words%add(']')
        end do
        call words%add('], "element_sections": [')
        do j = 1, size(b%kind)
          call words%add(either('', ', ', j == 1)//to_text(b%kinds(b%kind(j))%section))
        end do
      end associate
      json = words%all()//']'
    end function layers_of

    !> A truth value.
    function yes(x) result(json)
      logical, intent(in) :: x
      character(:), allocatable :: json
      json = either('true', 'false', x)
    end function yes

    !> What acts between two markers, with its direction in global axes.
    subroutine pair(name, kind, a, b, direction, rest)
      character(*), intent(in) :: name, kind
      type(marker_record), intent(in) :: a, b
      real(wp), intent(in) :: direction        !! from the section of b [rad]
      character(*), intent(in) :: rest        !! further members
      associate (at_b => pose(b))
        call text%member('', item(name, kind)//', "a": '//marker(a)//', "b": '//marker(b)//', "direction": '// &
                         json_number(direction + at_b(3))//rest//'}')
      end associate
    end subroutine pair

    !> Where a sensor measures; those of joints, drives, springs and stops at their marker a.
    type(marker_record) function measured(k) result(at)
      integer, intent(in) :: k                 !! sensor
      associate (r => d%sensors(k))
        at = r%marker
        if (r%joint > 0) at = d%joints(r%joint)%a
        if (r%drive > 0) at = d%drives(r%drive)%a
        if (r%force > 0) at = d%forces(r%force)%marker
        if (r%spring > 0) at = d%springs(r%spring)%a
        if (r%stop > 0) at = d%stops(r%stop)%a
        if (r%element > 0) at%node = m%s%bodies(at%body)%en(1, r%element)
      end associate
    end function measured

    !> A marker: its body (null: the ground), its node (0: a point), where it is.
    function marker(r) result(json)
      type(marker_record), intent(in) :: r
      character(:), allocatable :: json
      json = 'null'
      if (r%body > 0) json = json_text(trim(d%bodies(r%body)%name))
      json = '{"body": '//json//', "node": '//to_text(r%node)//', "at": '//position(r)//'}'
    end function marker

    !> Position of a marker.
    function position(r) result(json)
      type(marker_record), intent(in) :: r
      character(:), allocatable :: json
      associate (x => pose(r))
        json = vector(x(1:2))
      end associate
    end function position

    !> Position of a marker, and the angle of its section, of the frame where it has none.
    function pose(r) result(x)
      type(marker_record), intent(in) :: r
      real(wp) :: x(3)                         !! [m], [rad]
      real(wp) :: c, s
      x = [r%point, 0.0_wp]
      if (r%body == 0) return
      associate (b => m%s%bodies(r%body), frame => q(m%s%qo(r%body) + 1:m%s%qo(r%body) + 3))
        if (r%node > 0) x(1:2) = b%x(:, r%node)  ! assembly bends nothing
        c = cos(frame(3))
        s = sin(frame(3))
        x = frame + [c*x(1) - s*x(2), s*x(1) + c*x(2), x(3)]
      end associate
    end function pose
  end subroutine add_scene

  !> The beginning of an item: its name and its kind.
  function item(name, kind) result(text)
    character(*), intent(in) :: name, kind
    character(:), allocatable :: text
    text = '{"name": '//json_text(trim(name))//', "kind": '//json_text(trim(kind))
  end function item

  !> Numbers as a JSON list.
  function vector(x) result(text)
    real(wp), intent(in) :: x(:)               !! [m], [rad] or any other unit
    character(:), allocatable :: text
    integer :: k
    text = '['//json_number(x(1))
    do k = 2, size(x)
      text = text//', '//json_number(x(k))
    end do
    text = text//']'
  end function vector
end module scene_figures
