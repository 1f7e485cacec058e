!> Structure given by its matrices, for instance from another program or from a paper.
module hb_matrices
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_numbers, only: number_t, numbers_t
   use hb_structure, only: check_memory_of_structure, label_length, new_structure, structure_t
   use hb_structure_builder, only: matrix_slope_t, structure_builder_t
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: matrices_t, new_matrices, names_of_matrices

   character(26), parameter :: names_of_matrices(7) = [character(26) :: "mass", "damping", "gyroscopic", "stiffness", &
      "gyroscopic_by_speed", "stiffness_by_speed", "stiffness_by_speed_squared"]

   !> Numbers of one matrix: row by row, or those of its diagonal.
   type :: values_t
      real(wp), allocatable :: values(:)                     !! n_dofs**2 or n_dofs of them
   end type values_t

   type, extends(structure_builder_t) :: matrices_t
      integer :: n_dofs = 0
      type(values_t) :: of(size(names_of_matrices))                       !! in the order of their names
      real(wp) :: speed = 0.0_wp                             !! [rad/s], of the last three
      type(string_t), allocatable :: labels(:), units(:)     !! (n_dofs)
   contains
      procedure :: declare_numbers => matrices_declare_numbers
      procedure :: is_affine_in => matrices_is_affine_in
      procedure :: build => matrices_build
      procedure :: find_slope => matrices_find_slope
   end type matrices_t

contains

   subroutine matrices_declare_numbers(self, numbers)
      class(matrices_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("mass", self%of(1)%values)
      call numbers%add("damping", self%of(2)%values)
      call numbers%add("gyroscopic", self%of(3)%values)
      call numbers%add("stiffness", self%of(4)%values)
      call numbers%add("gyroscopic_by_speed", self%of(5)%values)
      call numbers%add("stiffness_by_speed", self%of(6)%values)
      call numbers%add("stiffness_by_speed_squared", self%of(7)%values)
      call numbers%add("speed", self%speed, required=has_speed(self))
      call self%proportional%declare_numbers(numbers)
   end subroutine matrices_declare_numbers

   !> Whether a matrix depends on the speed.
   pure logical function has_speed(self)
      class(matrices_t), intent(in) :: self
      integer :: i

      has_speed = .false.
      do i = 5, size(names_of_matrices)
         if (allocated(self%of(i)%values)) has_speed = has_speed .or. any(abs(self%of(i)%values) > 0.0_wp)
      end do
   end function has_speed

   pure logical function matrices_is_affine_in(self, number) result(is_affine)
      class(matrices_t), intent(in) :: self
      type(number_t), intent(in) :: number

      is_affine = number%key /= "speed"
   end function matrices_is_affine_in

   !> Derivatives by an element of mass, damping or stiffness.
   subroutine matrices_find_slope(self, number, slope, is_known)
      class(matrices_t), intent(in) :: self
      type(number_t), intent(in) :: number
      type(matrix_slope_t), intent(inout) :: slope
      logical, intent(out) :: is_known
      integer :: column, i, row

      call slope%begin()
      i = findloc(names_of_matrices, number%key, dim=1)
      is_known = any(i == [1, 2, 4]) .and. number%element(1) > 0
      if (.not. is_known) return
      associate (values => self%of(i)%values, element => number%element, n => self%n_dofs)
         if (size(values) == n) then
            row = element(1)
            column = row
         else if (element(2) > 0) then
            row = element(1)
            column = element(2)
         else
            row = 1 + (element(1) - 1)/n
            column = 1 + modulo(element(1) - 1, n)
         end if
      end associate
      select case (i)
      case (1)
         call slope%add(row, column, 1.0_wp, 0.0_wp, self%proportional%mass)
      case (2)
         call slope%add(row, column, 0.0_wp, 0.0_wp, 1.0_wp)
      case default
         call slope%add(row, column, 0.0_wp, 1.0_wp, self%proportional%stiffness)
      end select
   end subroutine matrices_find_slope

   !> Creates a structure without numbers: all are zero, labels are x1, x2, ... and units `m`.
   subroutine new_matrices(self, n_dofs)
      type(matrices_t), intent(out) :: self
      integer, intent(in) :: n_dofs
      integer :: i

      self%n_dofs = n_dofs
      allocate (self%labels(max(n_dofs, 0)), self%units(max(n_dofs, 0)))
      do i = 1, n_dofs
         self%labels(i)%value = "x"//to_text(i)
         self%units(i)%value = "m"
      end do
      do i = 1, size(names_of_matrices)
         allocate (self%of(i)%values(max(n_dofs, 0)), source=0.0_wp)
      end do
   end subroutine new_matrices

   subroutine matrices_build(self, structure, error, memory_limit)
      class(matrices_t), intent(inout) :: self
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit
      real(wp), allocatable :: damping(:, :), mass(:, :), stiffness(:, :)

      call check_memory_of_structure(self%n_dofs, error, memory_limit)
      if (.not. allocated(error)) call check_skew("gyroscopic", matrix(self, 3), error)
      if (.not. allocated(error)) call check_skew("gyroscopic_by_speed", matrix(self, 5), error)
      if (allocated(error)) return
      allocate (mass, source=matrix(self, 1))
      allocate (stiffness, source=matrix(self, 4))
      damping = matrix(self, 2) + matrix(self, 3) + self%proportional%matrix(mass, stiffness)
      if (has_speed(self)) then
         damping = damping + self%speed*matrix(self, 5)
         stiffness = stiffness + self%speed*matrix(self, 6)
         stiffness = stiffness + self%speed**2*matrix(self, 7)
      end if
      call new_structure(structure, mass, damping, stiffness, words(self%labels), words(self%units), error)
   end subroutine matrices_build

   subroutine check_skew(name, matrix, error)
      character(*), intent(in) :: name
      real(wp), intent(in) :: matrix(:, :)
      type(error_t), allocatable, intent(out) :: error

      if (maxval(abs(matrix + transpose(matrix))) > 1.0e-10_wp*maxval(abs(matrix))) &
         call fail(error, "matrices: the "//name//" matrix must be skew-symmetric, G(j, i) = -G(i, j); "// &
                   "dissipative terms belong to the damping matrix")
   end subroutine check_skew

   !> Matrix `i` in the order of their names, from its rows or from its diagonal.
   pure function matrix(self, i)
      class(matrices_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp) :: matrix(self%n_dofs, self%n_dofs)
      integer :: k

      associate (values => self%of(i)%values, n => self%n_dofs)
         if (size(values) == n**2) then
            matrix = transpose(reshape(values, [n, n]))
         else
            matrix = 0.0_wp
            do k = 1, n
               matrix(k, k) = values(k)
            end do
         end if
      end associate
   end function matrix

   !> Texts of a list in one length, long enough to detect those that are too long.
   pure function words(list)
      type(string_t), intent(in) :: list(:)
      character(label_length + 1) :: words(size(list))
      integer :: i

      do i = 1, size(list)
         words(i) = list(i)%value
      end do
   end function words
end module hb_matrices
